"""What may go wrong, who watches for it, and what current is still allowed."""
