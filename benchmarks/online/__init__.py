"""How good and how fast what is decided on the way is."""
