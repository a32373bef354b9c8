"""What the nodes share: shell, wire, conversions, parameters, diagnostics."""
