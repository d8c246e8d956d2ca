"""Simulate traffic with the Intelligent Driver Model."""
