"""Motion: from the track speeds on the ground to the pose of the vehicle, one model a file."""
