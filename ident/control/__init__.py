"""Closed loop: references, controllers, the truck that they drive, and what is measured of them."""
