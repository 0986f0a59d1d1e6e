"""Simulates for scripts written for CoppeliaSim."""
