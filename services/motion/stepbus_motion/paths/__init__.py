"""Paths of joints and of the tip, and motions along them."""
