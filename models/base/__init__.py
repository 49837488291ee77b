"""Units, geodesy, errors, files and how figures are put into words."""
