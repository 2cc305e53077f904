"""What a report says, gathered once from a solution: page, workbook and result file take their numbers from here."""
