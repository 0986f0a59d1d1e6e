"""V-REP's and CoppeliaSim's legacy remote API (`simx*`)."""
