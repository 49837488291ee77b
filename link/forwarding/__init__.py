"""Forwarding: other ground stations on the link of this one, routed by target, with the permissions set by the operator."""
