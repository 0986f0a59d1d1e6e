"""Participants and scenarios become FMUs: `stepbus export-fmu`."""
