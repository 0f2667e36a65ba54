"""Identification of the tool and of the bias of its force/torque sensor."""
