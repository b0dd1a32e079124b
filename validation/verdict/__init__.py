"""The verdict: the error of a model with its interval (ASME V&V 20), and what that allows to say."""
