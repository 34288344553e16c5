"""What every other room stands on: records, parameter declarations, errors."""
