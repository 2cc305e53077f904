"""What tests share: machines, campaigns, solutions made without a fit, files, judgements; each module holds one thing."""
