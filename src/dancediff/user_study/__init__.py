"""User studies: a page on which people compare dances blindly, and what their answers say."""
