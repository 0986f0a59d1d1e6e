"""The controller: from joint states and a reference to joint torques, by a law of your choice."""
