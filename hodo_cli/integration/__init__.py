"""One motion, without files: driven through an engine, its error measured, its crossings found.
Imports engines and what lies below."""
