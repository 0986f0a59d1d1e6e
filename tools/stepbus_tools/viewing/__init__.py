"""Shows recordings: pages, pictures and files for other programs."""
