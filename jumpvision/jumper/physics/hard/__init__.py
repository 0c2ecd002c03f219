"""Jumps on hard ground, exact: closed-form arcs from event to event."""
