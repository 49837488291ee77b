"""Forwarding: other ground stations on the link of this one, routed by target, allowed what the operator allows."""
