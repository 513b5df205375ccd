"""Who asked, where it is kept and how it is shown."""
