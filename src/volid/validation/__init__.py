"""A solution against readings that it was not made from (ISO/TR 16907 11.3)."""
