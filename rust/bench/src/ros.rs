//! `proact bench ros`: the nodes on a master of their own, measured by a node beside them.

use crate::{BenchFigure, BenchReport, quantile};
use proact_ros::node::NodeLatencies;
use std::{
    error::Error,
    net::TcpListener,
    process::{Child, Command, Stdio},
    time::Instant,
};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// The rate that the simulator is asked for, messages a second.
const RATE_HZ: f64 = 100.0;

/// Ends its process when it goes.
struct KillOnDrop(Child);

impl Drop for KillOnDrop {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// From a gesture's message to the joint command, and the rate of joint states and frames. About a minute.
pub(crate) fn ros() -> Outcome<BenchReport> {
    let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let uri = format!("http://127.0.0.1:{port}/");
    let start = |program: &std::path::Path, words: &[&str]| -> Outcome<KillOnDrop> {
        let child = Command::new(program)
            .args(words)
            .env("ROS_MASTER_URI", &uri)
            .env("ROS_IP", "127.0.0.1")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|e| format!("{} cannot be started: {e}", program.display()))?;
        Ok(KillOnDrop(child))
    };
    let port = port.to_string();
    let _master = start("rosmaster".as_ref(), &["--core", "-p", &port])
        .map_err(|e| format!("{e}; apt-get install python3-rosmaster brings it"))?;
    wait_for(&port)?;
    let program = std::env::current_exe()?;
    let sim = start(&program, &["node", "sim", "--setup", "still"])?;
    let method = start(&program, &["node", "method", "--method", "A", "--setup", "still"])?;
    let began = Instant::now();
    let cpu = || -> Outcome<[f64; 2]> { Ok([cpu_secs(sim.0.id())?, cpu_secs(method.0.id())?]) };
    let before = cpu()?;
    let meter = Command::new(&program)
        .args(["node", "meter"])
        .env("ROS_MASTER_URI", &uri)
        .env("ROS_IP", "127.0.0.1")
        .stderr(Stdio::inherit())
        .output()?;
    if !meter.status.success() {
        return Err(format!("the measuring node ended with {}", meter.status).into());
    }
    let measured: NodeLatencies = serde_json::from_slice(&meter.stdout)?;
    let (after, wall) = (cpu()?, began.elapsed().as_secs_f64());
    let mut figures = figures(&measured);
    let load = std::fs::read_to_string("/proc/loadavg")?;
    let load: f64 = load.split(' ').next().unwrap_or_default().parse()?;
    let note = format!("of one core, over {wall:.0} s, at a load of {load:.1}");
    for (k, name) in ["sim", "method"].iter().enumerate() {
        let share = 100.0 * (after[k] - before[k]) / wall;
        figures.push(BenchFigure::without_peer(&format!("node {name}, processor"), share, "%", &note));
    }
    figures.push(BenchFigure::without_peer(
        "load of the machine",
        load,
        "jobs",
        "mean of the last minute; figures above grow with it",
    ));
    Ok(BenchReport::new("ros", figures))
}

/// Processor time of a process so far, s.
fn cpu_secs(pid: u32) -> Outcome<f64> {
    // The kernel counts hundredths; the name before them may hold anything but a closing bracket at its end.
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat"))?;
    let (_, fields) = stat.rsplit_once(')').ok_or("/proc/PID/stat has no name")?;
    let ticks: Vec<f64> =
        fields.split_whitespace().skip(11).take(2).map(str::parse).collect::<Result<_, _>>()?;
    Ok(ticks.iter().sum::<f64>() / 100.0)
}

/// Waits until the master listens: ten seconds at most.
fn wait_for(port: &str) -> Outcome<()> {
    let give_up = Instant::now() + std::time::Duration::from_secs(10);
    while std::net::TcpStream::connect(format!("127.0.0.1:{port}")).is_err() {
        if Instant::now() > give_up {
            return Err("rosmaster does not listen after 10 s".into());
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    Ok(())
}

fn figures(measured: &NodeLatencies) -> Vec<BenchFigure> {
    let mut figures = Vec::new();
    let note = "emg message to joint command, both over TCP; goal: 99 % under 2 ms";
    for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
        let name = format!("class message to joint command, {name}");
        figures.push(BenchFigure::without_peer(&name, quantile(&measured.command_ms, share), "ms", note));
    }
    for (name, steps) in [("joint_states", &measured.joint_states_ms), ("tf", &measured.tf_ms)] {
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        let note = format!("set: {RATE_HZ} Hz, over {} messages; goal: within 1 %", steps.len());
        figures.push(BenchFigure::without_peer(&format!("{name}, rate"), 1e3 / mean, "Hz", &note));
        let off: Vec<f64> = steps.iter().map(|ms| (ms - 1e3 / RATE_HZ).abs()).collect();
        for (word, share) in [("median", 0.5), ("99 %", 0.99)] {
            let name = format!("{name}, step off by, {word}");
            figures.push(BenchFigure::without_peer(&name, quantile(&off, share), "ms", "as it arrives"));
        }
    }
    figures
}
