"""The state of the virtual device: tasks, reservations, watchdog timers, injected faults; no time passes here."""
