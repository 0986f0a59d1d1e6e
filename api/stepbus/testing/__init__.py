"""What tests of your own participants need."""
