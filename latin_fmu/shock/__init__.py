"""From the specification of a shock or a random vibration to a base history, and back.

==============  ===================================================================================
oscillators     response of oscillators on a moving base: what spectra are made of
specification   a specified shock response spectrum
base_histories  base accelerations that have a specified spectrum and come to rest
pulses          classical pulses with the loads before and after them that bring the base to rest
envelopes       spectra of several records as one specification
random_motion   a specified power spectral density, and stationary base motions that have it
==============  ===================================================================================
"""
