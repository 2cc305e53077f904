"""What goes to the machine with the files: the commissioning sheet, the sign check, the record, the control explained."""
