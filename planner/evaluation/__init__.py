"""Plans and policies flown in sampled realizations, with intervals on every figure."""
