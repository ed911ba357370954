"""What a diagnosis of a plan's measurement will detect, name and identify, and what undetected effects cost in use."""
