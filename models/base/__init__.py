"""Units, geodesy, errors, files and formatting."""
