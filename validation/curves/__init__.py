"""Measured and predicted curves as a reader gets them: one tidy table on one time base, its file, marks and plots."""
