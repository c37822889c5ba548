"""SUMO carries the traffic, the plant is the car, a driver sits in between."""
