"""A vehicle behind a link: every verb, two drivers."""
