"""The motion in pictures: first guesses at states, particles, multiple shooting."""
