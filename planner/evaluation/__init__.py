"""Evaluation of plans and policies in sampled realizations, with confidence intervals."""
