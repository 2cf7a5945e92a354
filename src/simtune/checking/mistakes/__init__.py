"""Mistakes in recordings: signs, columns, units, zeros and lengths that are not the model's."""
