"""What is asked, and one drone's view of it as arrays."""
