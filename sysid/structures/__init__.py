"""What can be fitted: model structures, their algebra, and the Model that comes out."""
