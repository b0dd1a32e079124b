"""What tracking gives: poses of every body in every frame, flags of frames that failed, and the result for the user."""
