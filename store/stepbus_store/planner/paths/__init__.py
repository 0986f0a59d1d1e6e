"""Motions of the joints: searched, timed, and monitored."""
