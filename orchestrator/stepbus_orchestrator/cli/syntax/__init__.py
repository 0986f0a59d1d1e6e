"""The commands of the core, a module for each group of the overview: options and help."""
