"""The order of a mission's independent parts: movable parts, the order that ends first, and the places of its pictures."""
