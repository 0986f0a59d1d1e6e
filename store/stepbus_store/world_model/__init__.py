"""The world model: where a robot is and what stands around it, by its own sensors and a map."""
