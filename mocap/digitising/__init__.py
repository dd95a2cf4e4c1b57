"""From film to tracks: dots found in windows that a filter predicts, named over all cameras, and clicks asked for."""
