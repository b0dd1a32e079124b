"""Simulations driven by a motion of the key: the force at the key front and the other bodies' motion follow.

Measured key angles come in, become a differentiable motion with uncertainty (`spline_fit`) and drive the action
(`prescribed_key`, `simulate`); `slow_press` moves the key at a steady speed.
"""
