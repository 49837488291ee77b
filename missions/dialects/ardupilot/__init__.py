"""What ArduPilot takes."""
