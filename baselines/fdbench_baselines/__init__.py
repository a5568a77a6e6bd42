"""Reference estimators, one file each and written as a third party would: file name = registered name.

A file whose name starts with an underscore is numerics shared by estimators, not an estimator.
"""
