"""A solution as a workbook: one sheet per table, for those who go on in a spreadsheet."""
