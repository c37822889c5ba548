"""Where the simulator and the road disagree, which effect causes it, and how far the gap shrinks."""
