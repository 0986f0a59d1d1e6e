"""Participants on other hosts: one port, mutual TLS, processes over SSH."""
