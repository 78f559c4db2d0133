"""Trains the detector of tier 3 and exports it for the host and for Hailo's compiler."""
