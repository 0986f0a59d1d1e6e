"""The lines of the plots, taken from a recording piece by piece."""
