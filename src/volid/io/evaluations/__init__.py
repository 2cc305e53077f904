"""What tests evaluated by a standard are read from, and limits: campaigns, tables, files of instruments."""
