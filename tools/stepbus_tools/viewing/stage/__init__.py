"""Draws scenes with viser: the page of a view, and the file of an export."""
