"""What a run of `tune` or `train` is made of (`Experiment`), and its life in a folder (`Run`)."""
