"""What is wrong with a session or looks wrong with the model: wiring, clocks, hum, lifts, odd trials, friction."""
