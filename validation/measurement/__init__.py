"""What was measured: usable trials with corrected force, zeroed angles and their uncertainties."""
