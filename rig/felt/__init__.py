"""The motor arm as a press for felts: orders, force profiles, readings, loading curves."""
