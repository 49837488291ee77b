"""What PX4 takes."""
