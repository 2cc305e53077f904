"""The ISG kernel, also sold as TwinCAT CNC, and the exchange text of ETALON, which it reads too."""
