"""Jumps with any mechanisms, compiled: adaptive steps, events, and rules that follow an event."""
