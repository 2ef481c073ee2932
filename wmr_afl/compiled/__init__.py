"""Closed loops as machine code: a traced step printed to C, built with the system's compiler, cached by content."""
