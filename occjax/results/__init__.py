"""Results of an estimate: the folder of files, and conversions between disparity, depth, points."""
