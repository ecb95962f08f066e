"""One prompt turn: the loop of inferences and tool calls. What it may do is decided in `control`."""
