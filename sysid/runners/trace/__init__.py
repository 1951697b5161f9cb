"""Recording a computation over arrays as C: what runs a step fast, and what exports it."""
