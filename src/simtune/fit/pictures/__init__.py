"""Colours and light, once the motion says where everything is."""
