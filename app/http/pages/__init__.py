"""The pages: routes that render templates, and the views that the templates show."""
