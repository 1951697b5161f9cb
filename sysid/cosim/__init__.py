"""Another machine in the loop: ROS nodes and a multibody simulation."""
