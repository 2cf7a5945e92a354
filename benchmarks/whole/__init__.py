"""Runs of the whole command in processes of their own: what whole_runs.py and precision.py share.

truths.py    the world of a run's number
variants.py  tasks that `simtune tune` does not have: `python -m whole.variants tune TASK ...`
run.py       one run, from its process's start to its result
lines.py     what is kept of it, a line of JSON each
parallel.py  runs side by side, each on cores of its own
measure.py   carries out those that have no line yet
summary.py   what the lines say together
"""
