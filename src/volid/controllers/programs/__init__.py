"""Programs of G-code, corrected in advance for controls that hold no table."""
