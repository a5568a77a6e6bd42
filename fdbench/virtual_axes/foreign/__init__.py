"""Foreign axes: kinds of machine, friction law, controller and logger that the library's own axis has not."""
