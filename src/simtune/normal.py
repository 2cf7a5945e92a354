"""Numbers of the normal distribution."""

STDS_90 = 1.645  # standard deviations on either side of the mean hold 90 %
MAD_TO_STD = 1.4826  # standard deviation over the median absolute deviation
