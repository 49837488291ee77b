"""What is worked out for the pages, in processes of their own: no module here knows NiceGUI."""
