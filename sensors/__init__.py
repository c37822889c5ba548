"""The sensor box: what a cheap logger would write, the reader of its card, and the digital road map."""
