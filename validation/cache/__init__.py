"""Results that need not be computed again, under one key rule."""
