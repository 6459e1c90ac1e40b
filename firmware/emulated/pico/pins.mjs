// The pins of a Pico with a heater (firmware/src/bin/heater.rs): the sensor's converter is channel 0, the heater is on PWM 2A.
const PIN = 20, SLICE = 2, PWM_FUNCTION = 4, CHANNEL = 0;

// The share of the time for which the heater's pin is up.
export function duty(pico) {
  const { pwm, gpio } = pico.chip, slice = pwm.channels[SLICE], pin = gpio[PIN];
  const drives = slice.csr & 1 && pin.functionSelect === PWM_FUNCTION && !pin.outputDisable;
  return drives ? Math.min(1, (slice.cc & 0xffff) / (slice.top + 1)) : 0;
}

// Calls `counts` at each conversion for what the sensor gives then.
export function connectSensor(pico, counts) {
  const { adc } = pico.chip, convert = adc.onADCRead;
  adc.onADCRead = (channel) => {
    if (channel === CHANNEL) adc.channelValues[CHANNEL] = counts();
    convert(channel);
  };
}
