"""The orchestrator: starts participants, drives them in lockstep, records them."""
