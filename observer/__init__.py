"""From a sensor log alone to the car's states, its thrust and its efficiency map. Never sees the truth."""
