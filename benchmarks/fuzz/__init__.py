"""Random requests that planners must answer or refuse."""
