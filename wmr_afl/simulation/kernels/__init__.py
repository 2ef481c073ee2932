"""How a traced step is run: as machine code, or by CasADi's virtual machine."""
