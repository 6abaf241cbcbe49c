//! Where samples come from, on the command line of every command that takes a live stream.

use clap::Args;
use proact_app::print_status;
use proact_devices::{DeviceError, FaultPolicy, SampleSource, SourceName, SourceOptions, SourceRegistry};

/// Options of a source.
#[derive(Debug, Args)]
pub struct SourceArgs {
    /// Where samples come from.
    #[arg(long)]
    pub(super) source: SourceName,
    /// Repetition that file:FOLDER plays and person:FOLDER makes.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub(super) source_repetition: u32,
    /// Play files and simulated people as fast as they can be read.
    #[arg(long)]
    pub(super) no_realtime: bool,
    /// The code of zero volts. Default: that of the model if it was trained on raw codes; else what the maker says,
    /// 128 at 8 bit, 2048 at 12 bit; 0 for files. Training: the median at rest.
    #[arg(long, value_name = "CODE")]
    pub(super) adc_zero: Option<f64>,
    /// Bits of the armband's converter: 8 up to 1000 Hz, 12 up to 500 Hz.
    #[arg(long, value_name = "N", default_value_t = 8)]
    adc_bits: u8,
    /// Bytes of a packet: 128 waits 16 ms at 1000 Hz, 32 waits 4 ms.
    #[arg(long, value_name = "N", default_value_t = 128)]
    packet_bytes: u8,
    /// Seed of simulated people and of the order of prompts.
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
}

impl SourceArgs {
    /// Opens the source at `rate` hertz, if one is asked for, with its inertial measurement unit if `imu`, and says what is found in
    /// recordings that it plays.
    ///
    /// # Errors
    /// A source that does not exist or cannot be opened, a rate that cannot be, recordings that `faults` refuses.
    pub(super) fn open(
        &self,
        sources: &SourceRegistry,
        rate: Option<f64>,
        imu: bool,
        faults: FaultPolicy,
    ) -> Result<Box<dyn SampleSource>, DeviceError> {
        let options = SourceOptions { imu, faults, ..self.source_options().at_rate(rate)? };
        let help = sources.find(&self.source)?.help;
        if self.source.scheme() == "keys" {
            print_status(help);
        }
        let source = sources.open(&self.source, &options)?;
        source.findings().iter().for_each(print_status);
        Ok(source)
    }

    /// What they say, beside the name.
    fn source_options(&self) -> SourceOptions {
        SourceOptions {
            repetition: self.source_repetition,
            as_fast_as_possible: self.no_realtime,
            adc_bits: self.adc_bits,
            packet_bytes: self.packet_bytes,
            seed: self.seed,
            rate_hz: None,
            imu: false,
            faults: FaultPolicy::default(),
        }
    }
}
