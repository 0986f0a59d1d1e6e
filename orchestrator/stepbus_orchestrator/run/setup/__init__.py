"""What a run is made of before its first phase: options, folder, and who is started."""
