"""Kernels: a traced step, run as machine code or by CasADi's virtual machine."""
