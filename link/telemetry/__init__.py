"""What a vehicle shows, brought to one time base, with doubts."""
