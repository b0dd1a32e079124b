"""Simulations driven by a motion of the key: the force at the key front and the other bodies' motion follow."""
