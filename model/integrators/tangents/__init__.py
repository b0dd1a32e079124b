"""Forward sensitivities (tangents) of a motion: its derivatives by parameters, integrated along it."""
