"""Where an arm may go for a goal, and along which route."""
