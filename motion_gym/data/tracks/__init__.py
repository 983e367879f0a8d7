"""Files of tracks of any form: tables, columns, times, units, and resampling to equal steps."""
