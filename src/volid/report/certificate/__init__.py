"""Certificate data for machines to read: a result file in the format of digital calibration certificates (DCC), unsigned."""
