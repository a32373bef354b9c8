"""Behaviour of arm and hand: grasp, lift, excite, put down."""
