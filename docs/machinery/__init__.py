"""What the site is made of beside its pages: each module writes one kind of file under docs/_generated."""
