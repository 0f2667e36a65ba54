"""The arm: its URDF, its kinematics and dynamics."""
