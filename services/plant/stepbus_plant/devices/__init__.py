"""Devices beside single joints: bases, grippers, contact sensors, cameras, poses of links."""
